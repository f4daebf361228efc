"""Episodes as files: lines of text as they are read, Parquet in a file of its own."""
