"""The planners that come with eigenfail."""
