"""Strict readers of mesh files: what a file declares is what is read, and everything else is refused by name."""
