"""What people read of the values: each table is built once here, and each number formatted once.

`figures` holds the rules for digits, `tables` the form of a table and of a cell; `campaigns`,
`suites`, `analyses` and `episodes` build the tables. `terminal` and `notebook` render them; the
pages of the dashboard and the reports render them with templates of their own.
"""
