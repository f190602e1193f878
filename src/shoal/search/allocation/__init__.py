"""Allocation of a tour to robots: tour costs, allocators and the resulting partition."""
