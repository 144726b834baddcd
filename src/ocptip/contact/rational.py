def solve(system, wrench):
    return None
