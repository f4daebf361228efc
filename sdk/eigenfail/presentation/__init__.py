"""Tables and formatted numbers for people; each table and each number format is defined once here.

`figures` holds the rules for digits, `tables` the form of a table and of a cell. `campaigns`,
`suites`, `analyses` and `episodes` build the tables. `terminal` and `notebook` render them; the
dashboard and the reports render them with their own templates.
"""
