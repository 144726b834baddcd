"""Where the base should stand: optimal placement at rest.

Equation numbers such as (4.21) are those of thesis M, chapter 4 (docs/bibliography.md).
"""
