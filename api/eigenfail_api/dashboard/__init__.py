"""Pages for browsers, made by the server from the same values that the API sends."""
