"""Objects of tests, written and read without the program."""

from seaclutter_cli.storage.objects import store_of


def put(url, data):
    """Write an object and return its URL."""
    import obstore

    obstore.put(store_of(url), url.key, data)
    return url


def get(url):
    """Return the content of an object."""
    import obstore

    return bytes(obstore.get(store_of(url), url.key).bytes())


def names(folder):
    """Return the names of the objects in a folder."""
    import obstore

    listed = obstore.list(store_of(folder), folder.key)
    return sorted(meta["path"].removeprefix(f"{folder.key}/") for batch in listed for meta in batch)
