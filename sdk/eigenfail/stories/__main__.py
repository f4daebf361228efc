"""Explains one episode: `eigenfail.stories.explaining` starts it and asks."""

from eigenfail import logs
from eigenfail.side_process import answer
from eigenfail.stories.explaining import reply

if __name__ == "__main__":
    logs.configure("controller")
    answer(reply)
