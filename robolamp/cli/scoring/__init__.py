"""What score, render and explain share: where a controller runs, and what its scores are in words."""
