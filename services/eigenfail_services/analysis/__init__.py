"""What failures have in common, and what they cost; pure functions over values."""
