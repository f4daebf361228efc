"""Reports on campaigns: gathered from the store, told in HTML, CSV and JSON.

A report is a list of sections. Each is one module in `sections` with a function `part`, which makes
the section's tables, sentences and drawings of the `Material`; `sections.PARTS` lists them.
"""
