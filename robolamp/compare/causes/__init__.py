"""Why lamp and twin differ: causes, ranked and put into words."""
