"""Files of strangers: mutated by the thousand, and what the readers say to them."""
