"""Scenes of obstacles, and the files that they are read from."""
