"""What to evolve: the task file, its fitness cases and terms, the twins it runs on."""
