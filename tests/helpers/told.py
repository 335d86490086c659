"""What ``info["shield"]`` tells of one row of many."""


def row_of(told, i):
    """The entries of row i, without the masks, nested as for one plant."""
    entries = {key: entry for key, entry in told.items() if key[0] != "_"}
    return {key: row_of(entry, i) if isinstance(entry, dict) else entry[i] for key, entry in entries.items()}
