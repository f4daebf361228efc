"""Values of eigenfail in notebooks: tables, data frames, arrays and diagrams."""

from eigenfail_notebook.frames import to_arrow, to_numpy, to_pandas
from eigenfail_notebook.plots import plot

__all__ = ["plot", "to_arrow", "to_numpy", "to_pandas"]
