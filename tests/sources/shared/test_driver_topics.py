"""The packet topic of every driver gives the same points as a capture of the same packets; containers take turns."""

import pytest

from tests.pairs import covering
from tests.sources.shared.driver_topics import DRIVERS, write_capture, write_topic
from tests.sources.shared.packet_bags import CONTAINERS
from tests.sources.shared.test_robosense_topics import clouds


@pytest.mark.parametrize(("name", "container"), covering(DRIVERS, CONTAINERS))
def test_a_topic_equals_a_capture_of_the_same_packets(name, container, tmp_path):
    driver = DRIVERS[name]
    from_capture, *_ = clouds(write_capture(driver, tmp_path / "log.pcap"), **driver.files(tmp_path), **driver.options)
    from_topic, _, damage, _ = clouds(write_topic(driver, container, tmp_path), **driver.options)
    (expected,), (found,) = from_capture.values(), from_topic.values()
    assert len(expected) > 1
    assert found == expected
    assert damage == []
