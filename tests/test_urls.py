"""What is a URL, and that secrets in one are never shown."""

import pickle
from pathlib import Path

import pytest

from seaclutter_cli.errors import UsageError
from seaclutter_cli.urls import Url, is_url, parse_url, place, without_secrets


@pytest.mark.parametrize(
    ("text", "url"),
    [
        ("s3://trial/day 1/log.mcap", Url("s3", "trial", "day 1/log.mcap")),
        ("s3://trial", Url("s3", "trial")),
        ("S3://trial/", Url("s3", "trial")),
        ("gs://my.bucket/a/b/", Url("gs", "my.bucket", "a/b")),
        ("az://container/*.bag", Url("az", "container", "*.bag")),
        (Path("s3://trial/log.mcap"), Url("s3", "trial", "log.mcap")),
        ("s3://trial/what?.mcap", Url("s3", "trial", "what?.mcap")),
    ],
)
def test_urls(text, url):
    assert parse_url(text) == place(text) == url
    assert is_url(text)
    assert parse_url(url) is url
    assert pickle.loads(pickle.dumps(url)) == url


@pytest.mark.parametrize("text", ["log.mcap", "/a/b", "C:\\logs", "C:/logs", "a:b", "s3", "s3:", "s3:log"])
def test_everything_else_is_a_path(text):
    assert place(text) == Path(text)
    assert not is_url(text)


def test_names_that_no_file_can_have():
    for text in ("", "a\0b", "\ud800", "x/" * 300, 5, None):
        with pytest.raises(UsageError):
            place(text)


@pytest.mark.parametrize(
    "text", ["s3://", "s3:///key", "s3://b/a//b", "s3://b/../c", "s3://b/./c", "ftp://a/b", "file:///a"]
)
def test_urls_that_name_nothing_are_refused(text):
    with pytest.raises(UsageError):
        place(text)


@pytest.mark.parametrize(
    "text",
    [
        "s3://KEY:SECRET@trial/log.mcap",
        "s3://SECRET@trial/log.mcap",
        "s3://KEY:SE/CR/SECRET@trial/log.mcap",
        "https://user:SECRET@host/log.mcap",
        "https://host/log.mcap?X-Amz-Algorithm=AWS4&X-Amz-Signature=SECRET",
        "https://account.blob.core.windows.net/c/log.mcap?sv=2024&sig=SECRET",
        "s3://trial/log.mcap?X-Amz-Signature=SECRET",
        "gs://trial/log.mcap?GoogleAccessId=a&Signature=SECRET",
        "s3://trial/log.mcap?password=SECRET",
        "gs://trial/log.mcap?access_token=SECRET",
        "s3://trial/*.mcap?x=a/SECRET",
        "s3://trial?password=SECRET",
        "s3://trial/log.mcap#token=SECRET",
        "s3://trial/log.mcap%3Fpassword%3DSECRET",
        "https://host/log.mcap?key=SECRET",
    ],
)
def test_secrets_are_refused_and_not_repeated(text):
    with pytest.raises(UsageError) as raised:
        place(text)
    assert "SECRET" not in str(raised.value)
    assert "credentials" in str(raised.value)
    assert "SECRET" not in without_secrets(text)


def test_parts():
    url = parse_url("s3://trial/day/log.labels.csv")
    assert (url.suffix, str(url.parent)) == (".csv", "s3://trial/day")
    assert url.parent.parent == url.parent.parent.parent == Url("s3", "trial")
    assert str(Url("s3", "trial") / "x") == "s3://trial/x"
