"""What deploy and dry-run put together around a run."""
