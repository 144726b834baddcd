"""Commands about recordings and simulators."""
