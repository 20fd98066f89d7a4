#!/usr/bin/env bash
# Run a command on the user's screen, or on a virtual one where there is none.
# VIRTUAL_SCREEN=1 asks for a virtual one in any case, so that tests never flash by.
set -u
if [ "$(uname -s)" != Linux ] || { [ -z "${VIRTUAL_SCREEN:-}" ] && [ -n "${DISPLAY:-}${WAYLAND_DISPLAY:-}" ]; }; then
  exec "$@"
fi
if ! command -v xvfb-run >/dev/null; then
  echo "no screen, and xvfb-run is missing: sudo apt-get install xvfb xauth" >&2
  exit 1
fi
# PyOpenGL would draw for Wayland by either of them.
unset WAYLAND_DISPLAY XDG_SESSION_TYPE
export QT_QPA_PLATFORM=xcb UNPACK_VIRTUAL_SCREEN=1 XDG_RUNTIME_DIR="${XDG_RUNTIME_DIR:-$(mktemp -d)}"
exec xvfb-run -a -s "-screen 0 1600x1000x24 +extension GLX" "$@"
