# Images without a Docker engine, and containers of them: for .ci/image, which has set $work.

fail() {
  echo "image: $*" >&2
  exit 1
}

step() {
  echo "-- $* (at $SECONDS s)"
}

server=
clean_up() {
  if [ -n "$server" ]; then kill -KILL "$server" 2> /dev/null || true; fi
  # An interrupted debootstrap or build leaves mounts; files below them are not ours to remove.
  grep -o " $work/[^ ]*" /proc/mounts | sort -r | xargs -r -n 1 umount --lazy || true
  rm -rf --one-file-system "$work"
}

buildah() {
  command buildah --root "$work/storage" --runroot "$work/runroot" --storage-driver vfs "$@"
}

# A Debian base from where this machine has its own packages: localhost/base.
make_base() {
  local suite=bookworm sources mirror base root
  sources=$(apt-get indextargets --format 'deb $(REPO_URI) $(RELEASE) $(COMPONENT)' 'Created-By: Packages' \
    | { grep -E " $suite(-updates|-security)? " || true; } | sort -u)
  mirror=$(awk -v suite="$suite" '$3 == suite { print $2; exit }' <<< "$sources")
  [ -n "$mirror" ] || fail "apt has no source for $suite"
  base=$(buildah from scratch)
  root=$(buildah mount "$base")
  debootstrap --variant=minbase "$suite" "$root" "$mirror" > "$work/debootstrap.log" 2>&1 \
    || { tail -n 20 "$work/debootstrap.log"; fail "debootstrap failed"; }
  echo "$sources" > "$root/etc/apt/sources.list"
  apt-config dump | grep -E '^Acquire::(Check-|http|ftp|Retries)' > "$root/etc/apt/apt.conf.d/99machine" || true
  rm -rf "$root"/var/cache/apt/* "$root"/var/lib/apt/lists/* "$root/etc/resolv.conf" "$root/etc/hostname"
  # As Debian's own images have it.
  buildah config --env PATH=/usr/local/sbin:/usr/local/bin:/usr/sbin:/usr/bin:/sbin:/bin "$base"
  buildah umount "$base" > /dev/null
  buildah commit --quiet --format docker --rm "$base" localhost/base > /dev/null
}

pip_setting() {
  python3 -m pip config get ":env:.$1" 2> /dev/null || python3 -m pip config get "global.$1" 2> /dev/null || true
}

# build DOCKERFILE NAME: the image localhost/NAME, its packages from where this machine has its own.
build() {
  local -a volumes=(--volume "$work/pip.conf:/etc/pip.conf:ro")
  local certificates name value
  certificates=$(pip_setting cert)
  {
    echo "[global]"
    if [ -n "$certificates" ]; then echo "cert = /etc/pip.pem"; fi
    for name in index-url proxy timeout; do
      value=$(pip_setting "$name")
      if [ -n "$value" ]; then echo "$name = $value"; fi
    done
  } > "$work/pip.conf"
  # Beside the package's bundle, which the build itself writes.
  if [ -n "$certificates" ]; then volumes+=(--volume "$certificates:/etc/pip.pem:ro"); fi
  buildah build --isolation chroot --format docker --file "$1" --build-arg BASE=localhost/base \
    --build-arg STEREOMEND=localhost/stereomend "${volumes[@]}" --tag "localhost/$2" . > "$work/build.log" 2>&1 \
    || { tail -n 60 "$work/build.log"; fail "the build of $1 failed"; }
  buildah images --format '{{.Name}} {{.Size}}' "localhost/$2"
}

config() {
  .venv/bin/python -c 'import json, sys
value = json.load(open(sys.argv[1]))["Docker"]["config"]
for name in sys.argv[2].split("."):
    value = value[name]
print(*([value] if isinstance(value, str) else value), sep="\0", end="\0")' "$work/image.json" "$1"
}

# open NAME: a container of localhost/NAME, as $root and what the image says of how to run it.
open() {
  local container file
  buildah inspect --type image "localhost/$1" > "$work/image.json"
  mapfile -d '' -t environment < <(config Env)
  mapfile -d '' -t entrypoint < <(config Entrypoint)
  mapfile -d '' -t command < <(config Cmd)
  mapfile -d '' -t user < <(config User)
  mapfile -d '' -t healthcheck < <(config Healthcheck.Test)
  [ "${healthcheck[0]}" = CMD ] || fail "the health check is not in exec form"
  data=$work/data-$1
  install --directory --owner "${user[0]%:*}" --group "${user[0]#*:}" --mode 0700 "$data"
  container=$(buildah from --pull-never "localhost/$1")
  root=$(buildah mount "$container")
  for file in etc/pip.conf etc/pip.pem; do
    [ ! -s "$root/$file" ] || fail "/$file of this machine is in the image"
  done
}

# contained [NAME=VALUE...] -- COMMAND...
# As an engine starts it with --read-only, --cap-drop=ALL and no-new-privileges: the process is number 1, its user
# and environment are the image's, no tmpfs is mounted, and the image's one volume is $data, a folder of that user.
# The folder $mounted, if any, is there as /mnt.
contained() {
  local -a given=()
  while [ "$1" != -- ]; do given+=("$1"); shift; done
  shift
  exec unshare --mount --pid --fork --kill-child bash -euc '
    root=$1 uid=$2 gid=$3 data=$4 mounted=$5
    shift 5
    mount --bind "$root" "$root"
    mount --rbind /dev "$root/dev"
    mount -t proc proc "$root/proc"
    if [ -n "$mounted" ]; then mount --bind "$mounted" "$root/mnt"; fi
    mount -o remount,bind,ro "$root"
    mount --bind "$data" "$root/data"
    exec chroot "$root" setpriv --reuid="$uid" --regid="$gid" --clear-groups --no-new-privs \
      --bounding-set=-all --inh-caps=-all env -i "$@"' \
    contained "$root" "${user[0]%:*}" "${user[0]#*:}" "$data" "${mounted:-}" "${environment[@]}" "${given[@]}" "$@"
}

healthy() {
  (contained "${settings[@]}" -- "${healthcheck[@]:1}") 2> /dev/null
}

# start [NAME=VALUE...]: a server with $settings, ready; $process is it, seen from outside.
start() {
  contained "${settings[@]}" "$@" -- "${entrypoint[@]}" "${command[@]}" > "$work/server.log" 2>&1 &
  server=$!
  for _ in {1..60}; do
    if healthy; then break; fi
    kill -0 "$server" 2> /dev/null || { cat "$work/server.log"; fail "the server ended"; }
    sleep 0.5
  done
  healthy || { cat "$work/server.log"; fail "not healthy after 30 s"; }
  process=$(pgrep -P "$server")
}

stop() {
  local began=$SECONDS code=0
  kill -TERM "$process"
  wait "$server" || code=$?
  server=
  [ "$code" -eq 0 ] || { cat "$work/server.log"; fail "it ended with $code on SIGTERM"; }
  [ $((SECONDS - began)) -le 5 ] || fail "it took $((SECONDS - began)) s to end on SIGTERM"
}

# refused CODE WORDS [NAME=VALUE...]: a server that must end so, with one line that has these words.
refused() {
  local code=0 expected=$1 words=$2
  shift 2
  (contained "$@" -- timeout 60 "${entrypoint[@]}" "${command[@]}") 2> "$work/refused.log" || code=$?
  if [ "$code" -ne "$expected" ] || [ "$(grep -vc ' INFO ' "$work/refused.log")" -ne 1 ] \
    || ! grep -q "$words" "$work/refused.log"; then
    cat "$work/refused.log"
    fail "it ended with $code, not with $expected and one line about $words"
  fi
}
