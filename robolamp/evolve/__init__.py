"""Evolving controllers: tasks, cases, fitness, genetic programming, constant tuning."""
