"""Machine code: of kernels, which are Python functions of plain loops, and of tapes of CasADi functions."""
