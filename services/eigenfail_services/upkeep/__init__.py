"""What a database needs beside its service: it is checked, mended, backed up and restored."""
