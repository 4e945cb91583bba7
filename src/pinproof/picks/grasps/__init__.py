"""Grasps from geometry: proposals for the fingers, the cup or the tip of a tool on any part."""
