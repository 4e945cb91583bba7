"""From a robot and meshes of parts to a cell: its scene, its picks, and the hand and home of the robot."""
