"""The digital orchard: photo-like stereo sessions of apple trees, with exact truth."""
