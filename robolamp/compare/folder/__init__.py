"""Many runs in one folder: how they go over time, and how well lamp and twin agree."""
