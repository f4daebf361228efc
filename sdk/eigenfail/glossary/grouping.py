"""The words for kinds of failures, for what is proof of them, and for comparisons."""

from eigenfail.glossary.term import Term

MODES = (
    Term(
        key="mode",
        name="Failure mode",
        words="A group of failures whose noise is alike. Modes are called distinct only where they "
        "stand out further than groups in noise do, and come back when failures are drawn again.",
        labels=("Failure modes", "Groups of failures"),
    ),
    Term(
        key="eigenfailure",
        name="Eigenfailure",
        words="The noise at the centre of a mode: what its failures have in common. It is no "
        "episode that happened until a replay proves that it fails.",
        unit="sigma",
        labels=("Eigenfailure", "Eigenfailures", "Eigenfailures reproduced"),
    ),
    Term(
        key="medoid",
        name="Medoid",
        words="The failure in the middle of its mode: an episode that happened.",
        labels=("Medoid", "Medoids", "Medoids reproduced"),
    ),
    Term(
        key="proof",
        name="Proof by replay",
        words="Eigenfailures and medoids are injected again, in the same scenario and in its "
        "neighbours; counted is how many of those tried fail again, with Wilson's interval.",
        labels=("Proof", "Proof by replay", "Eigenfailure reproduced", "Medoid reproduced"),
    ),
    Term(
        key="adjusted-rand-index",
        name="Adjusted Rand index",
        words="How alike the modes are to those of failures drawn again with replacement, as the "
        "median over the draws: 1 for the same groups, 0 for chance; from 0.8 on they are stable.",
        labels=("Adjusted Rand index",),
    ),
    Term(
        key="variance-explained",
        name="Variance explained",
        words="The share of what distinguishes the failures' noise that the principal components "
        "keep; modes are found in these.",
        unit="%",
        labels=("Variance explained",),
    ),
    Term(
        key="effective-modes",
        name="Effective modes",
        words="How many equally large modes would be as diverse: exp of the Shannon entropy of "
        "the modes' shares. 1 where all failures are in one.",
        unit="modes",
        labels=("Effective modes",),
    ),
    Term(
        key="spread",
        name="Spread",
        words="How much the failures' noise differs: the root mean square, over steps and axes, of "
        "its standard deviation between failures. Noise of p(x) has 1.",
        unit="sigma",
        labels=("Spread",),
    ),
    Term(
        key="all-modes-seen",
        name="All modes seen after",
        words="After which part of the campaign's episodes no new mode came: early means that "
        "more episodes would likely find the same modes again.",
        unit="%",
        labels=("All modes seen after",),
    ),
    Term(
        key="coverage",
        name="Failures inside",
        words="The share of all failures that a failing region holds, counted on the half of the "
        "episodes that was not used to find it.",
        unit="%",
        labels=("Failures inside", "Share of all failures"),
    ),
)

COMPARED = (
    Term(
        key="mcnemar",
        name="Pairs of episodes",
        words="Episodes that both sides ran under the same noise. McNemar's exact test asks "
        "whether one side fails more often where the other does not.",
        unit="pairs",
        labels=("Pairs of episodes",),
    ),
    Term(
        key="a12",
        name="A12",
        words="The probability that a campaign of these has a higher failure rate than one of the "
        "first, ties counted half (Vargha and Delaney): 0.5 is no difference.",
        labels=("A12",),
    ),
    Term(
        key="digest",
        name="Digest",
        words="SHA-256 over the results: two campaigns with the same digest gave the same "
        "episodes bit for bit.",
        labels=("Digest",),
    ),
)
