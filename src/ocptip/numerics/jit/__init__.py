"""Machine code: kernels that Numba compiles, and tapes of CasADi functions."""
