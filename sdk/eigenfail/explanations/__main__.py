"""Explains or replays stored episodes of one campaign, in a process of its own."""

from eigenfail import logs
from eigenfail.explanations.explaining import answer_question
from eigenfail.side_process import answer

if __name__ == "__main__":
    logs.configure("controller")
    answer(answer_question)
