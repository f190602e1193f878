"""Long work: a store of jobs in the folder, one process per running job, and the work of each kind of job."""
