"""Several motions in one task: what is carried and the gripper change between them, at standstill."""
