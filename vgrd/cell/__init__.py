"""The cell process: pairs, finds tags, records, answers, and takes commands.

May import every room of the daemon but gate and commands; a process, nobody imports it.
"""
