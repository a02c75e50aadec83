"""What a session is, and every way to make one."""
