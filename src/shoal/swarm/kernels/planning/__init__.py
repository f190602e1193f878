"""Plans of planners: base policy, beam search, rollouts, annealing."""
