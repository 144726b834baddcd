"""Do plans within a tolerance stand in a simulator that knows nothing but their exported data?"""
