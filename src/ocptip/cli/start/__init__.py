"""Commands that need no plan: files, pictures, completion."""
