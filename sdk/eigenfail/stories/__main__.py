"""Explains one episode: `eigenfail.stories.explaining` starts it and asks."""

from eigenfail.side_process import answer
from eigenfail.stories.explaining import reply

if __name__ == "__main__":
    answer(reply)
