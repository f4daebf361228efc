"""Reports on campaigns: gathered from the store, written as HTML, CSV and JSON.

A report is a list of sections. `report.PARTS` lists the functions that make the tables, sentences
and drawings of each section from the `Material`.
"""
