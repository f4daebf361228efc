"""`eigenfail`: every command.

Exit codes: 0 done, 1 failures found (with --gate), 2 usage error, 3 service error, 130
interrupted. Commands are loaded when they are called, not when they are listed: `eigenfail --help`
and shell completion must answer at once, and numpy and the HTTP client take longer.
"""

import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from difflib import get_close_matches
from enum import EnumType
from functools import partial
from importlib import import_module
from typing import Annotated, Any, NoReturn, get_args

import typer
from typer.core import TyperCommand, TyperGroup

from eigenfail import __version__, plugins
from eigenfail.command_line import checked_stdout, print_uncaught, report_uncaught
from eigenfail.errors import EigenfailError, InputError, InvalidValue, ServiceError

COMMANDS = {
    "up": "Start the service on this machine, on an embedded database.",
    "run": "Run the campaign that a TOML file describes, and print its results.",
    "campaign": "Create, monitor and control campaigns.",
    "suite": "Run many campaigns as one: a sweep, a grid, or a list of them.",
    "episode": "Show, export, replay and explain episodes.",
    "analyze": "Group the failures of a campaign into failure modes.",
    "mode": "List the failure modes of an analysis, name them, and track them to their end.",
    "release": "Compare the versions of a planner, failure mode by failure mode.",
    "compare": "Compare two campaigns, or several seeds of each.",
    "gate": "Check a new version of a planner against the failures of an earlier one.",
    "worker": "Run one worker for a service, or list the workers of a service.",
    "key": "Create, list, limit and revoke API keys; show the audit log.",
    "db": "Create, upgrade, verify, back up, restore and prune a database.",
    "doctor": "Check the installation, the service and the database.",
}

OF_THE_SERVER = frozenset({"db"})
"""Commands that the server's package brings."""

PLUGINS = {
    "evidence": "eigenfail-assurance",
    "noise": "eigenfail-noise-fit",
    "region": "eigenfail-failing-region",
    "report": "eigenfail-reports",
    "reproduce": "eigenfail-reproduction",
    "requirement": "eigenfail-assurance",
    "risk": "eigenfail-assurance",
    "webhook": "eigenfail-webhooks",
}
"""Commands that were once in the core, and the packages under plugins/ that bring them now."""

COMPLETION_OPTIONS = ("--install-completion", "--show-completion")


class DeferredCommand(TyperCommand):
    """Stands in for a command, or a group of commands, until it is called.

    Args:
        name: name of the command.
        text: what a list of commands says of it.
        load_app: imports the module of the command and returns its `app`.
        hidden: whether lists of commands leave it out.
    """

    def __init__(
        self, name: str, text: str, load_app: Callable[[], typer.Typer], hidden: bool = False
    ) -> None:
        super().__init__(name, help=text, hidden=hidden)
        self._load_app = load_app

    def load(self) -> Any:
        """Return the command itself."""
        from eigenfail.cli.options import name_values

        return name_values(typer.main.get_command(self._load_app()))

    def make_context(self, *args: Any, **extra: Any) -> Any:
        """Return the context of the command itself: from here on that command answers."""
        return _escape_help(self.load()).make_context(*args, **extra)


def load_app(module: str) -> typer.Typer:
    """Return the `app` of a module."""
    app: typer.Typer = import_module(module).app
    return app


def load_server_app(name: str) -> typer.Typer:
    """Return the commands of that name which the server's package brings.

    Raises:
        ServiceError: the server's package is not installed here.
    """
    try:
        app: typer.Typer = plugins.load(plugins.COMMANDS, name)
    except InputError as error:
        remedy = "Run in a clone: pip install '.[server,worker]'"
        raise ServiceError("The service is not installed here.", remedy) from error
    return app


def _escape_help(command: Any) -> Any:
    """Return a command whose help is printed literally, with all of its subcommands.

    Typer reads help as markup for terminals, in which a unit such as `[s]` is a style that nothing
    sees.
    """
    from rich.markup import escape

    for part in (command, *command.params):
        if text := getattr(part, "help", None):
            part.help = escape(text)
    for each in getattr(command, "commands", {}).values():
        _escape_help(each)
    return command


def defer(name: str) -> DeferredCommand:
    """Return the stand-in of a command that is loaded when it is called."""
    if name in OF_THE_SERVER:
        return DeferredCommand(name, COMMANDS[name], partial(load_server_app, name))
    return DeferredCommand(name, COMMANDS[name], partial(load_app, f"eigenfail.cli.{name}"))


def defer_plugins() -> Iterator[DeferredCommand]:
    """Yield the stand-ins of commands that other distributions bring, sorted by name.

    If several claim one name, its stand-in refuses: it takes the place of a command of the core,
    since a plug-in must neither replace one nor be ignored without a word.
    """
    brought = dict(sorted(plugins.list_claims(plugins.COMMANDS).items()))
    for name, points in brought.items():
        owners = {plugins.name_distribution(point) for point in points}
        if owners == {plugins.DISTRIBUTION}:
            continue
        if name in COMMANDS:
            owners.add(plugins.DISTRIBUTION)
        if len(owners) > 1:
            conflict = plugins.describe_conflict(plugins.COMMANDS, name, owners)
            text = f"Refused: claimed by {', '.join(sorted(owners))}."
            yield DeferredCommand(name, text, partial(refuse, conflict))
        else:
            text = plugins.describe_module(points[0].module) or f"Brought by {min(owners)}."
            yield DeferredCommand(name, text, partial(load_plugin_app, name))
    for name in PLUGINS.keys() - brought.keys():
        yield DeferredCommand(name, "", partial(refuse, describe_absence(name)), hidden=True)


def load_plugin_app(name: str) -> typer.Typer:
    """Return the commands of that name which a plug-in brings.

    Raises:
        InvalidValue: they cannot be loaded, or are no commands.
    """
    app = plugins.load(plugins.COMMANDS, name)
    if not isinstance(app, typer.Typer):
        kind = type(app).__name__
        raise InvalidValue(
            "command",
            f"'{name}' is of the type {kind}, and must be a typer.Typer.",
            "Fix its package.",
        )
    return app


def describe_absence(name: str) -> InputError:
    """Return the error of a command whose plug-in is not installed."""
    package = PLUGINS[name]
    problem = f"'eigenfail {name}' is in the package {package}, which is not installed here."
    return InputError("", problem, f"Run in a clone: pip install plugins/{package}")


def refuse(error: EigenfailError) -> NoReturn:
    """Raise the error of a command that cannot be run."""
    raise error


UsageError: type[Exception] = typer.BadParameter.__mro__[1]
"""The error of a command line that cannot be read. Typer exports only this subclass of it."""

HELP_ITSELF = "NoArgsIsHelpError"
JSON = "--json"

FAULTS = {
    "int_parsing": "is not an integer",
    "int_parsing_size": "is too large",
    "int_from_float": "is not an integer",
    "float_parsing": "is not a number",
    "greater_than_equal": "is below {ge}",
    "less_than_equal": "is above {le}",
}
"""Descriptions of invalid numbers, by the type of the error that pydantic reports."""


@contextmanager
def exit_on_error(as_json: bool) -> Iterator[None]:
    """Print errors of eigenfail and of usage in one line, and turn them into exit codes.

    For programs the line is the problem as JSON, the last line on standard error: progress may have
    been printed there before.
    """
    try:
        yield
    except EigenfailError as error:
        _exit(error, as_json)
    except UsageError as error:
        if type(error).__name__ == HELP_ITSELF:
            raise
        _exit(describe_wrong_usage(error), as_json)


def _exit(error: EigenfailError, as_json: bool) -> NoReturn:
    from eigenfail.values.access import redact
    from eigenfail.wire.http import encode, make_problem

    told = encode(make_problem(error)).decode() if as_json else f"eigenfail: {error}"
    # Standard error may hold progress before: a program reads the last line, which is the problem.
    with suppress(OSError):  # the exit code reports it where nothing can be written
        typer.echo(redact(told), err=True)
    raise typer.Exit(error.exit_code) from error


def describe_wrong_usage(error: Any) -> InputError:
    """Return the error of a malformed command line, with the likely intended word."""
    usage = f"See: {error.ctx.command_path} --help" if error.ctx else ""
    message, hint = error.format_message(), ""
    faults: list[dict[str, Any]] = getattr(error.__cause__, "errors", list)()
    # pydantic's own words are for programmers: "unable to parse string as an integer".
    if faults and faults[0]["type"] in FAULTS:
        return _describe_wrong_number(error.param, faults[0], usage)
    if options := getattr(error, "possibilities", None):
        message, hint = f"{error.message}.", f"Did you mean '{min(options)}'?"
    elif faults and faults[0]["type"] == "value_error":
        message = message.replace(faults[0]["msg"], str(faults[0]["ctx"]["error"]))
        hint = _suggest(faults[0]["input"], error.param.type_descriptor.annotation)
    message = message if message.endswith((".", "?")) else f"{message}."
    return InputError("", message, f"{hint} {usage}".strip())


def _describe_wrong_number(parameter: Any, fault: dict[str, Any], usage: str) -> InvalidValue:
    said = FAULTS[fault["type"]].format(**fault.get("ctx", {}))
    is_campaign = (parameter.metavar or "").startswith("CAMPAIGN")
    remedy = "`eigenfail campaign list` shows the ids." if is_campaign else usage
    name = parameter.get_error_hint().strip("'.")
    return InvalidValue(name, f"'{fault['input']}' {said}.", remedy)


def _suggest(given: object, kind: Any) -> str:
    # Choices are an enumeration, or the texts of a `Literal`; other types have none.
    members: list[Any] = list(kind) if isinstance(kind, EnumType) else list(get_args(kind))
    known = [str(getattr(member, "value", member)) for member in members]
    close = get_close_matches(str(given), known, n=1)
    return f"Did you mean '{close[0]}'?" if close else ""


def set_up_completion(context: typer.Context, args: Sequence[str]) -> NoReturn:
    """Print or install the script of a shell's completion, and end.

    Typer's own options take no shell and look for one among the parent processes: under cron, from
    a daemon or as the first process of a container there is none.

    Raises:
        InvalidValue: the shell is unknown, or none is named and none is found.
        Exit: it is done.
    """
    from eigenfail.cli import completion

    option, _, shell = args[0].partition("=")
    if not shell and len(args) > 1 and not args[1].startswith("-"):
        shell = args[1]
    program = context.find_root().info_name or "eigenfail"
    shell = completion.find_shell(shell)
    if option == "--show-completion":
        typer.echo(completion.make_script(program, shell))
    else:
        path = completion.install_script(program, shell)
        typer.echo(f"Completion for {shell} is installed in {path}. Start a new {shell} to use it.")
    raise typer.Exit


class Commands(TyperGroup):
    """The commands; an error raised on purpose is one sentence and an exit code."""

    def __init__(self, **given: Any) -> None:
        super().__init__(**given)
        for command in (*map(defer, COMMANDS), *defer_plugins()):
            self.add_command(command)

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Read what stands before the command."""
        # Not yet parsed: an error in the command line itself must be JSON, too.
        ctx.meta[JSON] = JSON in args
        if args[:1] == ["help"]:
            args = [*args[1:], "--help"]
        elif args[:1] == ["version"]:
            args = ["--version"]
        with exit_on_error(ctx.meta[JSON]):
            if args and args[0].partition("=")[0] in COMPLETION_OPTIONS:
                set_up_completion(ctx, args)
            return super().parse_args(ctx, args)

    def invoke(self, ctx: Any) -> Any:
        """Run the command that was asked for."""
        with exit_on_error(ctx.meta[JSON]):
            return super().invoke(ctx)


EPILOG = (
    "To begin: eigenfail doctor, eigenfail up and, in another terminal, eigenfail run FILE.toml. "
    "Every command takes --json. Exit codes: 0 done, 1 failures found or something differs, "
    "2 usage error, 3 service error, 130 interrupted."
)

app = typer.Typer(
    cls=Commands,
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    epilog=EPILOG,
    context_settings={"help_option_names": ["--help", "-h"]},
)


def show_version(wanted: bool) -> None:
    """Print the version, if it was asked for, and end."""
    if wanted:
        typer.echo(f"eigenfail {__version__}")
        raise typer.Exit


Version = Annotated[
    bool, typer.Option("--version", callback=show_version, is_eager=True, help="Print the version.")
]


@app.callback()
def eigenfail(version: Version = False) -> None:
    """Find the rare failures of a driving stack, group them into modes, prove and price them."""


def main() -> None:
    """The command line."""
    report_uncaught()
    try:
        with checked_stdout():
            app()
    except EigenfailError as error:  # the last bytes of the output could not be written
        with suppress(OSError):
            sys.stderr.write(f"eigenfail: {error}\n")
        sys.exit(error.exit_code)
    except Exception as error:  # noqa: BLE001 - typer sets a hook of its own, which hides nothing
        print_uncaught(error)
        sys.exit(1)
