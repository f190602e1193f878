"""Jobs of the studio: a store of jobs in the folder, one process per running job, and one function for each kind of job."""
