"""Pictures of a board -> a rig: corners, lenses, poses, and how far the result can be trusted."""
