"""ULog files of PX4: a topic is a table.

A further instance of a topic is called ``topic.1``, ``topic.2`` and so on.  Times stand in
``timestamp``, in us.  Rows count the topic's messages from 1.
"""

from __future__ import annotations

import io

from servo_models.logs.columns import Source, Tables, array_column, extra

SUFFIXES = (".ulg", ".ulog")


def read(source: Source) -> Tables:
    """Read a ULog file.

    Raises:
        UserError: it is damaged, or has no such topic.
    """
    pyulog = extra("ulog", "pyulog")
    try:
        topics = pyulog.ULog(io.BytesIO(source.content)).data_list
    except Exception as error:  # pyulog raises many kinds
        raise source.damaged("ULog") from error
    named = {t.name if t.multi_id == 0 else f"{t.name}.{t.multi_id}": t for t in topics}
    return Tables(
        {
            name: [array_column(field, values) for field, values in named[name].data.items()]
            for name in source.wanted(named)
        }
    )
