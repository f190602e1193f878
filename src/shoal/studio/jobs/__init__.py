"""Long work: a store of jobs in the folder, one process per running job, and the functions that do the work of each kind of job."""
