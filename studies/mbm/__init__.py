"""MotionBenchMaker problems as tasks of ocptip."""
