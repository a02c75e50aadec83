"""What people see: the viewer without a window, the web viewer in a browser, pictures compared."""
