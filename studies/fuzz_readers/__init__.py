"""Damaged files through every reader: each must end in one clear message, or be read::

    python -m studies.fuzz_readers                              # 200 inputs for each reader
    python -m studies.fuzz_readers --inputs 5000 --reader run   # one reader alone
    python -m studies.fuzz_readers --minutes 120                # as many as that takes, all readers in turn

`seeds` writes valid files of every format, `mutations` damages one of them, `readers` reads it as the program does, and
`hunting` judges how that ended. A finding is a traceback, a warning, a hang, output on the terminal, a message that is
too long, has the words of a library or no remedy, or files that are left although the input was refused. The damaged
file is kept. The same seed gives the same inputs.
"""
