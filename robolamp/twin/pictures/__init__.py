"""Pictures and videos of figures."""
