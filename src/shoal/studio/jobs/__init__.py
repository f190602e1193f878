"""Long work: a store of jobs in the folder, a process for each that runs, and what each kind of job does."""
