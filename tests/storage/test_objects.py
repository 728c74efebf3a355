"""Objects of a real object store: finding, listing and reading them, and errors with their causes."""

import json
import sys
import threading

import pytest

from seaclutter_cli.errors import InputError, MissingExtraError, SeaclutterError, UsageError
from seaclutter_cli.storage import objects
from seaclutter_cli.storage.objects import (
    cause,
    find_object,
    list_folder,
    list_objects,
    read_range,
)
from seaclutter_cli.urls import Url
from tests.storage.buckets import put
from tests.storage.proxy import Action
from tests.storage.server import KEYS

NAMES = ["a b/c d.mcap", "ü#1%/x?.mcap", "q[1]/z.mcap", "a%20b/x"]


@pytest.mark.parametrize("name", NAMES)
def test_an_object_is_found_by_its_name(bucket, name):
    url = put(bucket / name, b"content")
    found = find_object(url)
    assert (found.url, found.size) == (url, 7)
    assert read_range(found, 2, 5) == b"nte"
    assert read_range(found, 5, 100) == b"nt"
    assert read_range(found, 7, 100) == b""
    assert [one.url for one in list_objects(bucket)] == [url]


def test_a_missing_object_is_none(bucket):
    assert find_object(bucket / "none") is None
    assert find_object(bucket) is None
    assert list(list_objects(bucket / "none")) == []


def test_a_bucket_that_is_not_there(proxy):
    url = Url("s3", "not-there", "log.mcap")
    for ask in (find_object, lambda url: list(list_objects(url))):
        with pytest.raises(InputError, match=r"^s3://not-there/log.mcap: there is no bucket not-there$"):
            ask(url)


@pytest.mark.parametrize(
    ("access", "secret", "cause"),
    [
        ("unknownkey", "SECRET", "the credentials are not accepted (InvalidAccessKeyId)"),
        (KEYS["writer"][0], "SECRET", "the credentials are not accepted (SignatureDoesNotMatch)"),
        (*KEYS["stranger"], "access denied"),
    ],
)
def test_wrong_credentials(bucket, monkeypatch, access, secret, cause):
    put(bucket / "log.mcap", b"x")
    monkeypatch.setenv("AWS_ACCESS_KEY_ID", access)
    monkeypatch.setenv("AWS_SECRET_ACCESS_KEY", secret)
    with pytest.raises(InputError) as raised:
        list(list_objects(bucket))
    assert str(raised.value) == f"{bucket}: {cause}"
    with pytest.raises(InputError, match="access denied") as raised:
        find_object(bucket / "log.mcap")
    assert secret not in str(raised.value)
    assert raised.value.__cause__ is None
    assert raised.value.__suppress_context__


def test_a_listing_has_an_end(bucket, monkeypatch):
    """A server may repeat the same page for ever."""
    for number in range(4):
        put(bucket / f"logs/{number}.mcap", b"x")
    monkeypatch.setattr(objects, "MAX_OBJECTS", 3)
    for ask in (list_folder, lambda url: list(list_objects(url))):
        with pytest.raises(InputError, match="logs: more than 3 objects; name a folder or pattern with fewer"):
            ask(bucket / "logs")


def test_a_server_that_does_not_answer_is_an_error(bucket, proxy, monkeypatch):
    monkeypatch.setattr(objects, "_ANSWER_S", 0.1)
    go_on = threading.Event()
    proxy.rule = lambda _: go_on.wait(20) and None
    for ask in (find_object, list_folder, lambda url: list(list_objects(url))):
        with pytest.raises(InputError, match="the server gives no complete answer within"):
            ask(bucket / "log.mcap")
    go_on.set()


def test_a_size_that_no_object_has(bucket):
    with pytest.raises(InputError, match="1,000,000,000,000,000,000 bytes, which no object has"):
        objects._stored(bucket, {"size": 10**18, "e_tag": None})


@pytest.mark.parametrize(
    ("name", "value"),
    [
        *((name, "SEC\nRET") for name in ("AWS_ACCESS_KEY_ID", "AWS_SECRET_ACCESS_KEY", "AWS_SESSION_TOKEN")),
        ("AWS_SESSION_TOKEN", "schlüssel"),
        *(("AWS_ENDPOINT_URL", url) for url in ("junk", "http://[::", "http://a b", "http://127.0.0.1:99999")),
        ("AWS_ENDPOINT_URL", "http://a\nb"),
    ],
)
def test_settings_that_make_obstore_panic(bucket, monkeypatch, name, value):
    monkeypatch.setenv(name, value)
    with pytest.raises(UsageError, match=f"^s3://trial: {name} in the environment is not valid$"):
        find_object(bucket / "log.mcap")


def test_a_panic_is_an_error(bucket):
    kind = type("PanicException", (BaseException,), {})
    with pytest.raises(InputError, match="object storage failed; check the settings"), objects.explained(bucket):
        raise kind("SECRET")


@pytest.mark.parametrize("has_boto3", [False, True])
def test_no_credentials(proxy, few_retries, monkeypatch, tmp_path, has_boto3):
    for name in ("AWS_ACCESS_KEY_ID", "AWS_SECRET_ACCESS_KEY"):
        monkeypatch.delenv(name)
    if has_boto3:
        pytest.importorskip("boto3")
        monkeypatch.setenv("AWS_EC2_METADATA_DISABLED", "true")
        monkeypatch.setenv("AWS_SHARED_CREDENTIALS_FILE", str(tmp_path / "none"))
        monkeypatch.setenv("AWS_CONFIG_FILE", str(tmp_path / "none"))
    else:
        monkeypatch.setattr(objects, "find_spec", lambda _: None)
    monkeypatch.setenv("AWS_METADATA_ENDPOINT", "http://169.254.169.254.invalid")
    with pytest.raises(SeaclutterError, match="no credentials found; set AWS_ACCESS_KEY_ID"):
        find_object(Url("s3", "trial", "log.mcap"))


def test_a_profile(bucket, tmp_path, monkeypatch):
    pytest.importorskip("boto3")
    url = put(bucket / "log.mcap", b"x")
    access, secret = KEYS["writer"]
    for name in ("AWS_ACCESS_KEY_ID", "AWS_SECRET_ACCESS_KEY"):
        monkeypatch.delenv(name)
    file = tmp_path / "credentials"
    file.write_text(f"[trials]\naws_access_key_id = {access}\naws_secret_access_key = {secret}\n")
    monkeypatch.setenv("AWS_SHARED_CREDENTIALS_FILE", str(file))
    monkeypatch.setenv("AWS_EC2_METADATA_DISABLED", "true")
    monkeypatch.setenv("AWS_PROFILE", "trials")
    assert find_object(url).size == 1
    monkeypatch.setenv("AWS_PROFILE", "other")
    with pytest.raises(UsageError, match="AWS_PROFILE=other: cannot be used"):
        find_object(url)
    monkeypatch.setattr(objects, "find_spec", lambda _: None)
    monkeypatch.setenv("AWS_PROFILE", "third")
    with pytest.raises(UsageError, match="profiles need boto3"):
        find_object(url)


def test_a_server_that_fails_now_and_then(bucket, proxy):
    url = put(bucket / "log.mcap", b"0123456789" * 1000)
    for action in (Action(status=503), Action(reset_after=0), Action(reset_after=500)):
        proxy.fail(2, action)
        assert len(read_range(find_object(url), 0, 10_000)) == 10_000


@pytest.mark.parametrize(
    ("action", "cause"),
    [
        (Action(status=503), "the server answered 503 Service Unavailable"),
        (Action(reset_after=0), "the server cannot be reached, or the connection broke off"),
    ],
)
def test_a_server_that_always_fails(bucket, proxy, few_retries, action, cause):
    url = put(bucket / "log.mcap", b"x")
    proxy.fail(1000, action)
    with pytest.raises(InputError, match=cause):
        find_object(url)


def test_http_has_to_be_permitted(bucket, monkeypatch):
    monkeypatch.delenv("AWS_ALLOW_HTTP")
    with pytest.raises(InputError, match="AWS_ALLOW_HTTP=true permits HTTP"):
        find_object(bucket / "log.mcap")


def test_an_object_that_changes_is_not_mixed(bucket):
    url = put(bucket / "log.mcap", b"0123456789")
    found = find_object(url)
    put(url, b"abcdefghij")
    with pytest.raises(InputError, match=r"log.mcap: the object changed while it was read"):
        read_range(found, 0, 5)


def test_other_services_need_settings_too(monkeypatch):
    pytest.importorskip("obstore")
    monkeypatch.delenv("AZURE_STORAGE_ACCOUNT_NAME", raising=False)
    with pytest.raises(UsageError, match="set AZURE_STORAGE_ACCOUNT_NAME"):
        find_object(Url("az", "container", "log.mcap"))


@pytest.mark.parametrize("ask", [find_object, list_folder])
def test_the_error_names_the_extra(monkeypatch, ask):
    objects.open_store.cache_clear()
    for module in ("obstore", "obstore.store", "obstore.exceptions"):
        monkeypatch.setitem(sys.modules, module, None)
    with pytest.raises(MissingExtraError, match=r"^s3:// requires .* pip install 'seaclutter\[cloud\]'$"):
        ask(Url("s3", "trial", "log.mcap"))


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("status code: 301 Moved Permanently: <Code>PermanentRedirect</Code>", "in another region; set AWS_REGION"),
        ("Received redirect without LOCATION, an incorrectly configured region", "another region; set AWS_REGION"),
        (
            "PUT https://a/b?sig=SECRET status code: 409 Conflict: <Code>BlobBusy</Code>",
            "answered 409 Conflict, BlobBusy",
        ),
        ("something with SECRET", "object storage failed (GenericError)"),
    ],
)
def test_causes_are_found_in_the_texts_of_errors(text, problem):
    pytest.importorskip("obstore")
    from obstore.exceptions import GenericError

    found = cause(GenericError(text), Url("s3", "trial", "log.mcap"))
    assert problem in found
    assert "SECRET" not in found


def test_google_cloud_storage(server, bucket, tmp_path, monkeypatch):
    """Its interface is close enough to that of S3 for the server to answer."""
    put(Url("s3", "public", "log.mcap"), b"content")
    account = tmp_path / "account.json"
    keys = {"disable_oauth": True, "private_key": "", "private_key_id": "", "client_email": ""}
    account.write_text(json.dumps({"gcs_base_url": f"http://127.0.0.1:{server.port}", **keys}))
    monkeypatch.setenv("GOOGLE_SERVICE_ACCOUNT", str(account))
    found = find_object(Url("gs", "public", "log.mcap"))
    assert read_range(found, 0, 100) == b"content"
    with pytest.raises(InputError, match=r"^gs://trial/log.mcap: access denied$"):
        find_object(Url("gs", "trial", "log.mcap"))


def test_a_public_bucket_needs_no_credentials(proxy, monkeypatch):
    put(Url("s3", "public", "log.mcap"), b"content")
    for name in ("AWS_ACCESS_KEY_ID", "AWS_SECRET_ACCESS_KEY"):
        monkeypatch.delenv(name)
    monkeypatch.setenv("AWS_SKIP_SIGNATURE", "true")
    assert find_object(Url("s3", "public", "log.mcap")).size == 7
