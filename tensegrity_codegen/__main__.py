"""`python -m tensegrity_codegen` is `tensegrity-codegen`."""

from tensegrity_codegen.cli.supervised import main

if __name__ == "__main__":
    main()
