"""Closed-form inverse kinematics: all IK branches, derived from the geometry of the chain."""
