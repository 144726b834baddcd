"""Lean functions: counted, tidied, written as C."""
