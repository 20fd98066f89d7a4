#!/usr/bin/env bash
# Install the system's GL, Xvfb and Qt libraries where they are missing and we may.
# Says what to install by hand where we may not; never fails the build by itself.
# With the argument chromium also that, unless one of Chromium's kind is there.
set -u

declare -A needed=(
  [libEGL.so.1]=libegl1 [libGL.so.1]=libgl1 [libOpenGL.so.0]=libopengl0
  [libxkbcommon-x11.so.0]=libxkbcommon-x11-0 [libxcb-cursor.so.0]=libxcb-cursor0
  [libxcb-icccm.so.4]=libxcb-icccm4 [libxcb-image.so.0]=libxcb-image0
  [libxcb-keysyms.so.1]=libxcb-keysyms1 [libxcb-randr.so.0]=libxcb-randr0
  [libxcb-render-util.so.0]=libxcb-render-util0 [libxcb-shape.so.0]=libxcb-shape0
  [libxcb-xinerama.so.0]=libxcb-xinerama0 [libdbus-1.so.3]=libdbus-1-3
  [libfontconfig.so.1]=libfontconfig1 [libglib-2.0.so.0]=libglib2.0-0
)
[ "$(uname -s)" = Linux ] || exit 0

missing=()
libraries=$(PATH="$PATH:/sbin:/usr/sbin" ldconfig -p 2>/dev/null)
for library in "${!needed[@]}"; do
  case "$libraries" in *"$library "*) ;; *) missing+=("${needed[$library]}") ;; esac
done
command -v Xvfb >/dev/null || missing+=(xvfb)
command -v xauth >/dev/null || missing+=(xauth)
# Mesa's drivers are loaded by name at run time: libEGL alone draws nothing.
case "$libraries" in *"libEGL_mesa.so.0 "*|*"libEGL_nvidia.so.0 "*) ;; *) missing+=(libegl-mesa0) ;; esac
[ -n "$(ls /usr/lib/*/dri/swrast_dri.so /usr/lib/*/libgallium-*.so 2>/dev/null)" ] || missing+=(libgl1-mesa-dri)
if [ "${1:-}" = chromium ]; then
  command -v chromium chromium-browser google-chrome >/dev/null || missing+=(chromium)
fi
[ ${#missing[@]} -eq 0 ] && exit 0

if ! command -v apt-get >/dev/null; then
  echo "[setup] please install with your package manager what Debian calls: ${missing[*]}"
  exit 0
fi
become=()
if [ "$(id -u)" -ne 0 ]; then
  if command -v sudo >/dev/null && sudo -n true 2>/dev/null; then
    become=(sudo -n)
  else
    echo "[setup] please run once: sudo apt-get install ${missing[*]}"
    exit 0
  fi
fi
echo "[setup] system libraries: ${missing[*]}"
"${become[@]}" apt-get update -qq >/dev/null
if ! DEBIAN_FRONTEND=noninteractive "${become[@]}" apt-get install -y -qq "${missing[@]}" >/dev/null; then
  echo "[setup] apt-get could not install: ${missing[*]}; pictures may need them"
fi
exit 0
