"""Files of a plan: what is written, where its task comes from, and the motion as a controller runs it."""
