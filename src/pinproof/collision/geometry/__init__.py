"""Shapes of obstacles and robots: primitives, meshes, convex hulls and pieces, occupancy grids and depth images."""
