"""Planning kernels: base policy, beam search, rollouts, annealing."""
