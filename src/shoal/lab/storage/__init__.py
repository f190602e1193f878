"""The store of a sweep: one SQLite file, its lock, its checks, its tables."""
