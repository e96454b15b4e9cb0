"""Tasks: what is learned, its environments and levels of difficulty."""
