"""Sweeps: many settings of a method on the same pictures, and which of them is best."""
