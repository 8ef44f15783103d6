"""Many lamps or figures side by side, on the engine: under controllers, or sent goals."""
