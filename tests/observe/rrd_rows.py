"""A recording read back: the rows of a component, the entities, the timelines, what the blueprint shows."""

from typing import NamedTuple

import rerun.chunk as rrd


class Row(NamedTuple):
    t_s: float | None  # None: for always
    sample: int | None
    value: list


def chunks(path):
    return list(rrd.RrdReader(path).stream())


def entities(path):
    return {chunk.entity_path.strip("/") for chunk in chunks(path)}


def timelines(path):
    return {name for chunk in chunks(path) for name in chunk.timeline_names}


def rows(path, entity, component):
    """Of the entity, or of all whose path begins with it and a slash, in the order of the samples."""
    found = []
    for chunk in chunks(path):
        name = chunk.entity_path.strip("/")
        if name == entity or name.startswith(f"{entity}/"):
            batch = chunk.to_record_batch()
            columns = dict(zip(batch.schema.names, batch.columns, strict=True))
            if component in columns:
                found += _rows(columns, component, batch.num_rows)
    return sorted(found, key=lambda row: (row.sample or 0, row.t_s or 0))


def _rows(columns, component, number):
    nothing = [None] * number
    times = columns["emulated_time"].cast("int64").to_pylist() if "emulated_time" in columns else nothing
    samples = columns["sample"].to_pylist() if "sample" in columns else nothing
    for t_ns, sample, value in zip(times, samples, columns[component].to_pylist(), strict=True):
        if value is not None:
            yield Row(None if t_ns is None else t_ns / 1e9, sample, value)


def blueprint_ids(path):
    return {store.recording_id for store in rrd.RrdReader(path).blueprints()}


def blueprint(path, but=()):
    """The values of a component in the one blueprint whose id is not in `but`, wherever it is in it."""
    reader = rrd.RrdReader(path)
    (store,) = (one for one in reader.blueprints() if one.recording_id not in but)
    found = {}
    for chunk in reader.stream(store=store):
        batch = chunk.to_record_batch()
        for name, column in zip(batch.schema.names, batch.columns, strict=True):
            if ":" in name:
                found.setdefault(name, []).extend(value for value in column.to_pylist() if value is not None)
    return found
