"""Kernels of the planners: base policy, beam search, rollouts and annealing."""
