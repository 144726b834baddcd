"""CasADi expressions of legs and platform in the order in which elimination needs them."""
