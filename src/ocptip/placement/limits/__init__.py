"""The limits of a placement: one class per kind."""
