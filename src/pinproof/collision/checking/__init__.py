"""Collision checks of configurations: bodies, pairs, coal, separating directions, moving objects, audits by samples."""
