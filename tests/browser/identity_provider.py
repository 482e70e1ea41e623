"""A small identity provider (OpenID Connect, authorization code with PKCE) that believes whoever says who they are."""

import base64
import hashlib
import json
import secrets
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from urllib.parse import parse_qs, parse_qsl, urlencode, urlsplit

from joserfc import jwt
from joserfc.jwk import RSAKey

CLIENT, SECRET = "crashfuse", "not-so-secret"
PEOPLE = ("anna@example.com", "ben@example.com")


class _Provider(ThreadingHTTPServer):
    """The provider's state: its key, and what was asked for with each code that it gave out."""

    def __init__(self) -> None:
        super().__init__(("127.0.0.1", 0), _Answers)
        self.issuer = f"http://127.0.0.1:{self.server_address[1]}"
        self.key = RSAKey.generate_key(2048, {"kid": "one", "use": "sig", "alg": "RS256"})
        self.asked: dict[str, dict[str, str]] = {}

    def token(self, form: dict[str, str], basic: str) -> dict[str, object]:
        """What a code, the client's secret and the verifier of the code are exchanged for."""
        asked = self.asked.pop(form["code"])
        challenge = base64.urlsafe_b64encode(hashlib.sha256(form["code_verifier"].encode()).digest()).rstrip(b"=")
        assert asked["code_challenge"] == challenge.decode()
        assert base64.b64decode(basic.removeprefix("Basic ")).decode() == f"{CLIENT}:{SECRET}"
        now = int(time.time())
        claims = {"iss": self.issuer, "aud": CLIENT, "iat": now, "exp": now + 600, "nonce": asked["nonce"]}
        claims |= {"sub": asked["person"], "email": asked["person"]}
        signed = jwt.encode({"alg": "RS256", "kid": "one"}, claims, self.key)
        return {"access_token": "a", "token_type": "Bearer", "expires_in": 600, "id_token": signed}


class _Answers(BaseHTTPRequestHandler):
    server: _Provider

    def do_GET(self) -> None:
        """Tell what the provider offers and its key, ask who someone is, send them back."""
        address = urlsplit(self.path)
        asked = dict(parse_qsl(address.query))
        issuer = self.server.issuer
        if address.path == "/.well-known/openid-configuration":
            places = {"authorization_endpoint": "who", "token_endpoint": "token", "jwks_uri": "keys"}
            places["end_session_endpoint"] = "forget"
            told = {name: f"{issuer}/{place}" for name, place in places.items()}
            self._tell({"issuer": issuer, "code_challenge_methods_supported": ["S256"], **told})
        elif address.path == "/keys":
            self._tell({"keys": [self.server.key.as_dict(private=False)]})
        elif address.path == "/who":
            page = "<title>Who are you?</title>"
            for person in PEOPLE:
                code = secrets.token_urlsafe()
                self.server.asked[code] = {**asked, "person": person}
                back = urlencode({"code": code, "state": asked["state"]})
                page += f'<a href="{asked["redirect_uri"]}?{back}">{person}</a><br>'
            self._answer(200, page.encode(), ("Content-Type", "text/html"))
        elif address.path == "/forget":
            self._answer(302, b"", ("Location", asked["post_logout_redirect_uri"]))
        else:  # a browser asks for an icon
            self._answer(404, b"", ("Content-Type", "text/plain"))

    def do_POST(self) -> None:
        """Exchange a code."""
        form = self.rfile.read(int(self.headers["Content-Length"])).decode()
        parsed = {name: values[0] for name, values in parse_qs(form).items()}
        self._tell(self.server.token(parsed, self.headers["Authorization"]))

    def _tell(self, told: dict[str, object]) -> None:
        self._answer(200, json.dumps(told).encode(), ("Content-Type", "application/json"))

    def _answer(self, status: int, content: bytes, header: tuple[str, str]) -> None:
        self.send_response(status)
        self.send_header(*header)
        self.send_header("Content-Length", str(len(content)))
        self.end_headers()
        self.wfile.write(content)

    def log_message(self, format: str, *args: object) -> None:  # noqa: A002 - the base class's name
        """Nothing is logged."""


@contextmanager
def identity_provider() -> Iterator[str]:
    """Run the provider; gives the address of its metadata."""
    with _Provider() as provider:
        threading.Thread(target=provider.serve_forever, daemon=True).start()
        yield f"{provider.issuer}/.well-known/openid-configuration"
        provider.shutdown()
