"""What everything computes with: Ipopt, compiled kernels, batches of CasADi functions."""
