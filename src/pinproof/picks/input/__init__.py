"""What is picked: grasps, places, grippers, frames, and the files and sources that they are read from."""
