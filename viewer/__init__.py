"""Results and sessions before the eyes."""
