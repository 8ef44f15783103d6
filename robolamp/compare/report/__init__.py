"""The pages that a comparison is read on."""
