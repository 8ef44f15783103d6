"""What individuals are made of: Koza's trees, Ferreira's chromosomes."""
