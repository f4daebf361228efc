"""The methods: learners that choose disturbances, pure and testable with no service around them."""
