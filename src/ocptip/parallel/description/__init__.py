"""What a parallel robot is: its legs as tables, platform, motors, frames; ready-made robots."""
