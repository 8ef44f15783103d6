"""What a run truly did, and how good that was."""
