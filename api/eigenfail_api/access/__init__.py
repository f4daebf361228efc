"""Access: authentication, scopes, and the record of changes."""
