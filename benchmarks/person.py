"""A person at the dashboard whose browser is elsewhere: what the server does for them, and nothing of their drawing."""

from collections.abc import Iterator
from contextlib import contextmanager

import websocket
from streamlit.proto.BackMsg_pb2 import BackMsg
from streamlit.proto.ForwardMsg_pb2 import ForwardMsg

_LONGEST_S = 60.0


class Person:
    """One session, which asks for pages as a browser does."""

    def __init__(self, connection: websocket.WebSocket) -> None:
        self._connection = connection
        self._pages: dict[str, str] = {}
        self._ask(BackMsg())

    @classmethod
    @contextmanager
    def at(cls, address: str) -> Iterator["Person"]:
        """Someone who has opened the dashboard at an address."""
        stream = address.replace("http", "ws", 1) + "/_stcore/stream"
        connection = websocket.create_connection(stream, timeout=_LONGEST_S, origin=address, subprotocols=["streamlit"])
        try:
            yield cls(connection)
        finally:
            connection.close()

    def turn_to(self, page: str) -> None:
        """Ask for a page, and take all of it."""
        message = BackMsg()
        message.rerun_script.page_script_hash = self._pages[page.lower()]
        self._ask(message)

    def _ask(self, message: BackMsg) -> None:
        message.rerun_script.query_string = ""
        self._connection.send_binary(message.SerializeToString())
        answer = ForwardMsg()
        # A run that is asked for while another goes on ends that one early.
        while not (
            answer.WhichOneof("type") == "script_finished"
            and answer.script_finished == ForwardMsg.FINISHED_SUCCESSFULLY
        ):
            answer.ParseFromString(self._connection.recv())
            if answer.WhichOneof("type") == "navigation":
                self._pages = {page.url_pathname: page.page_script_hash for page in answer.navigation.app_pages}
