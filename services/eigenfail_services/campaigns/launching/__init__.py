"""Who starts workers, how many, and what becomes of them: Ray, or nobody here."""
