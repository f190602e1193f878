"""Which robot searches which part of the tour: what a tour costs, allocators, the partition that results."""
