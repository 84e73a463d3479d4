export { BufferAttribute, BufferGeometry, AmbientLight, DirectionalLight, LineBasicMaterial, LineSegments, Mesh, MeshBasicMaterial,
  MeshLambertMaterial, OrthographicCamera, Raycaster, Scene, SphereGeometry, Vector2, Vector3, WebGLRenderer, DoubleSide, Color } from "three";
export { OrbitControls } from "three/examples/jsm/controls/OrbitControls.js";
