"""`python -m eigenfail`: the command line, if no script of that name is on the path."""

from eigenfail.cli.main import main

if __name__ == "__main__":
    main()
