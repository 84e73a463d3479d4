"""``python -m flexdesign``."""

from flexdesign.cli import main

if __name__ == "__main__":
    main()
