"""The published modular arms, their eight cases with printed solutions, and an arm known by its axes.

Tables, sections and equation numbers such as (6.14) are those of thesis M (docs/bibliography.md).
"""
