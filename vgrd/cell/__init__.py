"""The cell process: pairs, finds tags, records, answers, and takes commands."""
