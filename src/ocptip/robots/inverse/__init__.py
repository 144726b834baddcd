"""Joint angles of a gripper pose: closed form where there is one, else by search."""
