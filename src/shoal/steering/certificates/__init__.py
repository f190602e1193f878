"""Proofs that no plan is shorter than a bound: the search for them, and their checker."""
