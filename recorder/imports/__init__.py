"""Ways in: pictures, labels and recordings of others -> sessions."""
