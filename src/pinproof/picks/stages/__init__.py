"""The stages of a pick, a file each, over the configurations at the grasp."""
