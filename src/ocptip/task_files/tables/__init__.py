"""Readers of tables that several kinds of files share."""
