"""The command line: the front door of the house."""

from __future__ import annotations

import sys
import traceback

from twin.cli import interrupts
from twin.errors import BadInputError, TwinError

EXIT_OK, EXIT_FAILED, EXIT_BAD_INPUT, EXIT_INTERNAL, EXIT_INTERRUPTED = 0, 1, 2, 3, 130


def main() -> None:
    """Run the command line and exit with the code the contract names.

    0 all checks hold; 1 a check failed or a baseline drifted; 2 bad input; 3 an error of ours, with traceback;
    130 interrupted.
    """
    interrupts.listen()
    try:
        code = _run()
    except KeyboardInterrupt:
        code = EXIT_INTERRUPTED
    except BrokenPipeError:
        sys.stderr.close()
        code = EXIT_OK
    if code == EXIT_INTERRUPTED:
        print("interrupted", file=sys.stderr)
    sys.exit(code)


def complain(error: TwinError) -> None:
    """Say what cannot be used; where the user's own code failed, its traceback before."""
    trace = error.trace if isinstance(error, BadInputError) else ""
    print(f"{trace}error: {error}", file=sys.stderr)


def _run() -> int:
    import typer  # noqa: PLC0415  (loaded after the signal handlers are in place)

    from twin.cli.app import app  # noqa: PLC0415

    try:
        outcome = app(standalone_mode=False)
    except typer.Exit as stop:
        return int(stop.exit_code)
    except typer.Abort:
        raise KeyboardInterrupt from None
    except typer.TyperException as error:
        told = error.format_message() if isinstance(error, typer.BadParameter) else str(error)
        print(f"error: {told}", file=sys.stderr)
        return EXIT_BAD_INPUT
    except TwinError as error:
        complain(error)
        return EXIT_BAD_INPUT
    except (KeyboardInterrupt, BrokenPipeError):
        raise
    except Exception:
        if interrupts.interrupted():
            return EXIT_INTERRUPTED
        traceback.print_exc()
        print("This is an error in agtwin, not in your input. Please report it with the lines above.", file=sys.stderr)
        return EXIT_INTERNAL
    return int(outcome or EXIT_OK)
