"""Robots in three dimensions in a browser: views of motions and scenes, and the studio."""
